"""SSD's module that writes nets for training, which is not here."""

raise ImportError('caffe.model_libs is a module of weiliu89/caffe (branch ssd): copy python/caffe/model_libs.py from there next to '
                  'your script and import it as model_libs; it needs only caffe.layers, caffe.params and caffe.NetSpec')
